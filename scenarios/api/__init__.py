"""Which functions does a notebook call? The public names of `flexbeams`, one module for each topic."""
