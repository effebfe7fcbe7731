"""The study of how closely physical vehicles keep to the published routes.

Takes the routes of the library; writes its record.

Imports: experiments.findings experiments.flight sim
"""
