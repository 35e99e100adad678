"""Which functions does a notebook call? The public names of `flexbeams`, a module for each topic."""
