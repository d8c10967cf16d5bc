"""Recordings in files: tables and bags; read ``open_recording`` first."""
