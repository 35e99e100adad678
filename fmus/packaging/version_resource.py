"""Version information of Windows libraries, which the file's properties show there."""

from flexbeams.fmus.interface.variables import Interface


def version_resource(interface: Interface, file: str, version: str) -> str:
    """A resource script (.rc) for the library `file` of a unit."""
    numbers = [int(n) if n.isdecimal() else 0 for n in version.split(".")[:4]]
    listed = ",".join(map(str, [*numbers, 0, 0, 0, 0][:4]))
    texts = {
        "CompanyName": "flexbeams contributors",
        "FileDescription": f"{interface.unit_name}, FMI 2.0 co-simulation unit",
        "FileVersion": version,
        "InternalName": interface.unit_name,
        "LegalCopyright": "flexbeams contributors, BSD-2-Clause",
        "OriginalFilename": file,
        "ProductName": "flexbeams",
        "ProductVersion": version,
    }
    values = "\n".join(f'            VALUE "{name}", "{text}"' for name, text in texts.items())
    return f"""1 VERSIONINFO
FILEVERSION {listed}
PRODUCTVERSION {listed}
FILEOS 0x40004
FILETYPE 2
BEGIN
    BLOCK "StringFileInfo"
    BEGIN
        BLOCK "040904B0"
        BEGIN
{values}
        END
    END
    BLOCK "VarFileInfo"
    BEGIN
        VALUE "Translation", 0x409, 1200
    END
END
"""
