"""What is computed, as the user says it: amplitudes, laws, materials, parts and interfaces."""
