"""Reading untrusted XML: without entities or a DTD, checked against the schemas of SSP 1.0 shipped with FMPy."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from flexbeams.fmus.documents.xml_documents import SSD, SSM, SSV
from flexbeams.plant.errors import InputError

_SCHEMAS = {
    SSD: "SystemStructureDescription.xsd",
    SSV: "SystemStructureParameterValues.xsd",
    SSM: "SystemStructureParameterMapping.xsd",
}


def read_document(content: bytes, source: str) -> Any:
    """The root element; InputError for malformed XML and for a document type declaration."""
    parser = etree.XMLParser(
        resolve_entities=False, load_dtd=False, no_network=True, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise InputError("", f"is not well-formed XML: {error.msg}", source=source) from None
    if root.getroottree().docinfo.doctype:
        raise InputError("", "must have no document type declaration", source=source)
    return root


def detached(element: Any) -> Any:
    """A copy of an element as the root of a separate document."""
    return etree.fromstring(etree.tostring(element, with_tail=False))


def schema_problems(root: Any, namespace: str) -> list[str]:
    """Violations of the schema of SSD or SSV, one line each."""
    schema = _schema(namespace)
    if schema.validate(root):
        return []
    return [f"line {entry.line}: {re.sub(r'{[^}]*}', '', entry.message)}" for entry in schema.error_log]


@cache
def _schema(namespace: str) -> Any:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / _SCHEMAS[namespace]))
