"""What rays that bend in a thermocline do to fixes, positions and formations.

Imports: experiments.study laisn reports sim
"""
