"""Recordings in files: CSV, bags, chamber tables; read ``recordings`` first."""
