"""Registration of the Gymnasium environments."""

from flexbeams.plant.errors import InputError

TRACKING = "flexbeams/Tracking-v0"


def register_environments() -> None:
    """Registers `flexbeams/Tracking-v0` with Gymnasium, unless it is there already; needs the extra `gym`.

    The environment is described in `flexbeams.scenarios.learning.tracking.TrackingEnvironment`.

    Raises
    ------
    InputError
        Where gymnasium is not installed.

    Examples
    --------
    >>> import flexbeams as fb, gymnasium
    >>> fb.register_environments()
    >>> env = gymnasium.make("flexbeams/Tracking-v0", episode_time=0.1)
    >>> observation, info = env.reset(seed=1)
    >>> env.action_space.shape, observation.shape
    ((4,), (14,))
    >>> env.close()
    """
    try:
        import gymnasium
    except ImportError:
        rule = "needs the package gymnasium (pip install 'flexbeams[gym]')"
        raise InputError("register_environments", rule) from None
    if TRACKING not in gymnasium.registry:
        gymnasium.register(id=TRACKING, entry_point="flexbeams.scenarios.learning.tracking:TrackingEnvironment")
