"""The report: a page to hand on, and a PDF.

``chapter`` turns a result into ``blocks`` (tables, pictures, surfaces, findings); kinds that need
more are in ``surface_chapters`` and ``others``. ``html`` and ``pdf`` write the same chapters,
``tolerances`` judges them, ``load`` reads results from files, ``report`` is the whole.
"""
