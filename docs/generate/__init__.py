"""The parts of `docs/reference/` that are made of the code, so that they cannot differ from it.

`python -m docs.generate` writes them anew; `tests/contracts/test_docs.py` compares.
"""
