"""The files of a bag, record by record."""
