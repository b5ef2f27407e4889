"""How well the camera source sees, measured on rendered pictures. May import gazempc."""
