"""Recordings in files: tables and bags; read ``read`` first."""
