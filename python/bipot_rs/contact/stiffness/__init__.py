"""What K says of itself: digits, rigid motions, the order of degrees of freedom."""
