"""Recordings in files: CSV and bags; read ``recordings`` first."""
