"""What a leader that is not level does to its followers: `study` is where it begins."""
