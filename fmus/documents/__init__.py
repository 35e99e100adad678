"""Documents inside an FMU: description, page, picture."""
