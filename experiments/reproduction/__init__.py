"""The paper's evaluation, flown again: `study` is where it begins."""
