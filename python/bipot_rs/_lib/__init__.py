"""What every layer uses: checks of arguments, words of messages, optional libraries."""
