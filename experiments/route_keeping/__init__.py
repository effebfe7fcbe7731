"""The study of how closely physical vehicles keep to the published routes.

Takes the routes of the library; writes `docs/tracking.md`.

Imports: experiments.flight sim
"""
