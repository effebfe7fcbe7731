"""A formation that crosses a front, where the current changes within some metres.

Imports: experiments.study reports
"""
