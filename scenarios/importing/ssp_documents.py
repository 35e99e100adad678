"""XML documents of an extracted SSP: found, read, of a known version and valid by their schema."""

from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from flexbeams.fmus.documents.xml_documents import SSC, SSD, SSM, SSV
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.xml_reading import detached, read_document, schema_problems

STRUCTURE = "SystemStructure.ssd"
VERSIONS = ("1.0", "2.0")  # of SSP; documents of 2.0 are read as far as they keep to 1.0
NS = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "ssm": SSM}


class SspFolder:
    """A package extracted to a folder; `source` names it in errors."""

    def __init__(self, folder: Path, source: str) -> None:
        self.folder, self.source = folder, source

    def document(self, where: str, namespace: str) -> Any:
        """The root of a document of the package, valid by the schema of its namespace."""
        path = self.folder / where
        if not path.is_file():
            raise InputError(where, "must be in the package", source=self.source)
        try:
            root = read_document(path.read_bytes(), where)
        except InputError as error:
            raise InputError("", str(error), source=self.source) from None
        self._require_valid(root, namespace, where)
        return root

    def require_embedded(self, element: Any, namespace: str) -> None:
        """InputError for an element within SystemStructure.ssd that is no valid document of that namespace."""
        self._require_valid(detached(element), namespace, STRUCTURE)

    def _require_valid(self, root: Any, namespace: str, where: str) -> None:
        version = root.get("version", "1.0")
        if version not in VERSIONS:
            raise InputError(where, f"must be of SSP {' or '.join(VERSIONS)}, its version", version, source=self.source)
        root.set("version", "1.0")  # of the schema here; namespaces and content of 1.0 are those of 2.0
        if problems := schema_problems(root, namespace):
            raise InputError(where, f"must be valid by the schema of SSP 1.0: {problems[0]}", source=self.source)

    def file(self, uri: str, key: str) -> Path:
        """A file of the package by its URI; nothing outside is opened."""
        parts = urlsplit(uri)
        where = PurePosixPath(unquote(parts.path))
        inside = not (
            parts.scheme
            or parts.netloc
            or where.is_absolute()
            or ".." in where.parts
            or "\\" in str(where)
            or "\0" in str(where)
        )
        path = self.folder.joinpath(*where.parts) if inside else self.folder
        if not inside or not path.resolve().is_relative_to(self.folder.resolve()):
            raise self.error(key, "must be a path inside the package", uri)
        if not path.is_file():
            raise self.error(key, "must be a file in the package", uri)
        return path

    def error(self, key: str, rule: str, value: object = None) -> InputError:
        """An error that names SystemStructure.ssd."""
        return InputError(key, rule, value, source=f"{self.source}: {STRUCTURE}")
