"""The pictures and numbers of README and docs: `make figures`.

Takes what the studies recorded and what it flies itself; writes into `docs`. It works in a checkout only.

Imports: experiments laisn sim
"""
