"""What does a person type and see? The command `flexbeams`: a module for each verb, options and tables."""
