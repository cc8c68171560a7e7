"""Claimed errors against true ones, over thousands of random cases."""
