"""For maintainers, in a checkout only and not in the wheel: documents, benchmarks and mutation
tests.

The packages of the product import nothing from here.
"""
