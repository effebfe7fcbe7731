"""Names of files by which folders of results are told apart."""

STUDY_FILE = "campaign.json"
FLIGHT_FILE = "summary.json"
"""A file that each folder of a study, and each folder of a flight, has."""
