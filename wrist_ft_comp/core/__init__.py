"""The mathematics: pure functions over frozen records."""
