"""The study of followers that steer by their own estimates.

Takes the routes of the library and the navigators; writes its record and draws its figure.

Imports: experiments laisn sim
"""
