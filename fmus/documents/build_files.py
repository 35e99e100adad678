"""Files beside the sources of a native unit that say how to compile them: buildDescription.xml, CMakeLists.txt."""

from xml.etree import ElementTree

from flexbeams.fmus.documents.xml_documents import xml_bytes

_CMAKE = """# Builds {unit} from its sources:
#     cmake -S sources -B build -DFMI2_HEADERS=<folder with fmi2Functions.h> && cmake --build build
# gives a shared library for binaries/; with -DBUILD_SHARED_LIBS=OFF a static one for a rig, whose functions are called
# {unit}_fmi2Instantiate and so on.
cmake_minimum_required(VERSION 3.15)
project({unit} C)

set(FMI2_HEADERS "" CACHE PATH "Folder with fmi2Functions.h and the other two headers of FMI 2.0")
option(BUILD_SHARED_LIBS "A shared library with the plain names of FMI; otherwise a static one with prefixed names" ON)
if(NOT EXISTS "${{FMI2_HEADERS}}/fmi2Functions.h")
  message(FATAL_ERROR "FMI2_HEADERS must be the folder with fmi2Functions.h of FMI 2.0, got '${{FMI2_HEADERS}}'")
endif()
if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library({unit} {source})
target_include_directories({unit} PRIVATE "${{FMI2_HEADERS}}")
set_target_properties({unit} PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF
                      C_VISIBILITY_PRESET hidden POSITION_INDEPENDENT_CODE ON)
if(BUILD_SHARED_LIBS)
  target_compile_definitions({unit} PRIVATE FMI2_OVERRIDE_FUNCTION_PREFIX)
  set_target_properties({unit} PROPERTIES PREFIX "")
endif()
if(NOT MSVC)
  target_compile_options({unit} PRIVATE -ffp-contract=off)
  if(CMAKE_SIZEOF_VOID_P EQUAL 4 AND CMAKE_SYSTEM_PROCESSOR MATCHES "^(i[3-6]86|[xX]86|x86_64|AMD64|amd64)$")
    target_compile_options({unit} PRIVATE -msse2 -mfpmath=sse) # the x87 rounds to doubles only where it stores them
  endif()
  target_link_libraries({unit} PUBLIC m)
endif()
"""


def build_description(unit: str, source: str) -> bytes:
    """buildDescription.xml of FMI 3.0, which FMI 2.0.4 allows and prefers to SourceFiles: one C99 file, no definitions.

    The file itself defines the prefix of its functions.
    """
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=unit)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    ElementTree.SubElement(files, "SourceFile", name=source)
    return xml_bytes(root)


def cmake_lists(unit: str, source: str) -> bytes:
    """CMakeLists.txt for a shared or a static library of the unit."""
    return _CMAKE.format(unit=unit, source=source).encode()
