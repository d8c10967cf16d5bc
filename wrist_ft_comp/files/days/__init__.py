"""Days at work, a recording each, and the diary that tells what became of them."""
