"""Which numbers does a finished run have? Checks, curves, file formats, comparison."""
