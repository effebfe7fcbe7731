"""Followers that steer by their own estimates, on all routes and with each navigator.

Imports: experiments.flight experiments.study reports
"""
