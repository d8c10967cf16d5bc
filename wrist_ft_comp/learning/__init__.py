"""A model that learns day by day; read ``model_choice`` first, then ``incidents``."""
