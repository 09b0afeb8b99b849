"""One solution of a problem in files of another program."""
