"""Runs the contact model beside the stream; records; shows."""
