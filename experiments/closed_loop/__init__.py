"""The study of followers that steer by their own estimates.

Takes the routes of the library and the navigators; writes `docs/closed-loop.md` and its figure.

Imports: experiments.campaign experiments.flight experiments.pages experiments.route_keeping laisn sim
"""
