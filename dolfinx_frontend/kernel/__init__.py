"""The one crossing to the compiled kernel, and how it is run."""
