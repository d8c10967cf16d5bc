"""
What is mounted on the sensor, and how gravity and motion come to its frame.

``weight`` has the two records that live and offline share; everything here is numpy alone.
"""
