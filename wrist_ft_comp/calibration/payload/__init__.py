"""Recordings of a robot at work: payload, contacts and tares of the driver apart from drift."""
