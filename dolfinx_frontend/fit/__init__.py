"""What measured data leave of the inputs of a function."""
