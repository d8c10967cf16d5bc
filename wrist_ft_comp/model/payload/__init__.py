"""What is mounted on the sensor, and how gravity and motion come to its frame, by numpy alone."""
