"""How topics are opened and heard, whatever their type, and what of the input is doubtful."""
