"""Scripts that measure what the documentation claims, one for each subject.

Run one with `python -m benchmarks.NAME`; with `--json` it prints one object
{name: {value, unit, baseline, ratio}}.
"""
