"""Bytes of messages: header and wrench, any field of any message, TF; for bags and nodes."""
