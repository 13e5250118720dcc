"""From a scene to matrices: parts, paired interfaces, what holds them, and their ranks."""
