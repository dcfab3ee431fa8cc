"""The command line: one command, sub-commands."""
