"""What a reference page shows of a room: every name that its `__init__` gives to readers as `X as
X`, and those of its public modules, below the words of the page itself."""

import griffe


class PublicNames(griffe.Extension):
    """Reads the re-exports of each room, so that no list of names has to be kept beside them."""

    def on_package(self, *, pkg: griffe.Module, **kwargs) -> None:
        del kwargs
        for room in pkg.modules.values():
            # The docstring of a room speaks to those who change it; that of a module stands on the
            # pages of the physics.
            room.docstring = None
            for module in room.modules.values():
                if module.exports is not None:
                    module.docstring = None
            if room.is_init_module and room.exports is None:
                room.exports = [
                    name
                    for name, origin in room.imports.items()
                    if origin.rsplit(".", 1)[-1] == name
                    and origin.startswith(pkg.name)
                    and name not in room.modules
                ]
