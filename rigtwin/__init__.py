"""Public API of rigtwin."""
