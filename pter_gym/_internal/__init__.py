"""What every room may use and no user needs: files, tables, plain data, the terminal, colours."""
