"""The demonstration: ``plan`` says what runs, ``result`` what came of it."""
