"""What every node needs and no feature; read ``hub`` first."""
