"""Mutation tests: `make mutants` changes the sources one place at a time and runs the tests that
cover the place.
"""
