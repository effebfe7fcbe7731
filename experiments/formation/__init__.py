"""The study of followers that keep formation on what they hear.

Takes conditions of sea, sound and sensors; flies ten followers through each, run by run; writes its record.

Imports: experiments laisn sim
"""
