"""The study of followers that keep formation by what they receive.

Imports: experiments.flight experiments.study laisn reports sim
"""
