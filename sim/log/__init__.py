"""Flights as MCAP logs: `writer` and `reader`, and what they share."""
