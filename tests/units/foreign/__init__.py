"""Third-party units of the tests: one compiled library, and a description and rules for each unit."""
