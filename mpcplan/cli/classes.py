"""The classes that a configuration names, looked up before anything is driven."""

from collections.abc import Iterator

from mpcplan.config import Config
from mpcplan.plug.named import Part, class_named


def check_classes(config: Config) -> None:
    """Finds all classes that a configuration names: a wrong name is an error at once.

    Raises:
        InputError: a name leads to no usable class.
    """
    for spec, part in _named(config):
        class_named(spec, part)


def _named(config: Config) -> Iterator[tuple[str, Part]]:
    """The names with what they are for; a stage is imported only where one of its is named."""
    if ":" in config.predict.kind:
        from mpcplan.predict.foreign import PREDICTOR

        yield config.predict.kind, PREDICTOR
    if config.seed.sources:
        from mpcplan.seed.foreign import SOURCE

        yield from ((spec, SOURCE) for spec in config.seed.sources)
    for spec in (config.refine.backend, config.refine.fresh_backend):
        if ":" in spec:
            from mpcplan.refine.foreign import BACKEND

            yield spec, BACKEND
