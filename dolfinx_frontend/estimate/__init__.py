"""How far an answer is off: recovered stress, errors of the meshes, accuracy on request."""
