"""What a simulated robot at work publishes beside its sensor."""
