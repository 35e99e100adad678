"""A scenario as an SSP package that needs nothing else: units, connections, signals, start values, diagram."""

from collections.abc import Callable, Sequence
from pathlib import Path

from flexbeams.fmus.documents.xml_documents import parameter_set
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.choices import SspVersion
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.bundle import ExportBundle, build_bundle, parameters_of
from flexbeams.scenarios.exporting.ssd import fmu_path, parameter_set_path, structure_document


def export_ssp(
    name: str,
    out: Path,
    settings: Settings,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = lambda text: None,
    *,
    ssp_version: SspVersion = "1.0",
    flags_as_real: bool = False,
) -> Path:
    """Writes a scenario as FILE.ssp; raises the same errors as `build_bundle`. Equal arguments give equal bytes."""
    with temporary_folder() as folder:
        bundle = build_bundle(name, folder, settings, platforms, notify, flags_as_real=flags_as_real)
        entries = {fmu_path(bundle, component): file.read_bytes() for component, file in bundle.files.items()}
    write_whole(out, zip_bytes(entries | package_documents(bundle, ssp_version)))
    return out


def package_documents(bundle: ExportBundle, version: SspVersion = "1.0") -> dict[str, bytes]:
    """SystemStructure.ssd and the parameter set of each component, by path."""
    documents = {"SystemStructure.ssd": structure_document(bundle, version)}
    for name, unit in bundle.units.items():
        if parameters := parameters_of(unit):
            documents[parameter_set_path(name)] = parameter_set(
                name, [(v.name, v.type, v.start, v.unit) for v in parameters], version
            )
    return documents
