"""What a recording is and what runs on it, by numpy; ``signals`` first, ``drift_model`` on top."""
