"""Registration of the Gymnasium environments; an entry point calls it when gymnasium is imported."""

TRACKING = "flexbeams/Tracking-v0"


def register() -> None:
    """Registers `flexbeams/Tracking-v0`, unless it is there already."""
    import gymnasium

    if TRACKING not in gymnasium.registry:
        gymnasium.register(id=TRACKING, entry_point="flexbeams.scenarios.learning.tracking:TrackingEnvironment")
