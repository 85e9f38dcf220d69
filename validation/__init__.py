"""This library beside the numbers of others: `python -m validation`, or `make validation`."""
