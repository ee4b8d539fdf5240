"""What ``xden-build`` can do, a module for each family of commands."""
