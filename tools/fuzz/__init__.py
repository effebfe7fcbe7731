"""Broken inputs of users, by chance: tables, SDF files, studies and settings, logs and plugins.

`python -m tools.fuzz` gives them to the commands. A fault is an answer that no input may get: a bug
in the program, a half-written or silent result, a page of text, a minute of waiting.
"""
