"""What a run did and why, in words, from its trace."""
