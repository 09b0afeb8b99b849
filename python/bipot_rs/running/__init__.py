"""One run of the command: what it foretells, does, tells and leaves in its folder."""
