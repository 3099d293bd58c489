"""The documentation; `docs.generate` makes the parts of it that the code knows better."""
