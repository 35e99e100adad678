"""The command line: one module a verb, options, tables."""
