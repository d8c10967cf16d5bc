"""Learning from one day after another: recordings and models in, verdicts out."""
