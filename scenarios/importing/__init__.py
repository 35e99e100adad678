"""What do third-party FMUs and packages contain? Archives and XML from untrusted sources, SSP, OSP."""
