"""The report: a page to hand on, and a PDF.

``chapters`` turns each kind of result into chapters of ``blocks`` (tables, pictures, surfaces,
findings); ``html`` and ``pdf`` write the same chapters. ``tolerances`` judges them, ``load`` reads
results from files.
"""
