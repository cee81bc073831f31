"""Helpers of every room, not for users: files, tables, plain data, the terminal, colours."""
