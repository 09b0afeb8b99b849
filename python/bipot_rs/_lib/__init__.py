"""Used by every layer: checks of arguments, parts of messages, optional libraries."""
