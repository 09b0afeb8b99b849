"""What is said of a problem or an answer: reasons, remarks and names of rigid motions."""
