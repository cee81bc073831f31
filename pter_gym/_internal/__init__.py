"""Helpers of all subpackages, not for users: checks, files, tables, plain data."""
