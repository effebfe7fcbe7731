"""Processor time and memory beside other implementations and lower limits, measured in one run:
`make bench`.
"""
