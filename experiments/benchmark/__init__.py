"""LAISN-Bench: measurements of followers in a fixed set of missions, and scores of estimates made
from them.
"""
