"""The study of 1999: its experiments, its claims, its figures, and the report that puts them side by side."""
