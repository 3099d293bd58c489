"""What an engineer computes from signals: pure functions of arrays."""
