"""The viewer of surfaces: a page of plain JavaScript and WebGL2 that needs no server.

``pack`` turns results into compact bytes: ``content`` brings them into one form, ``framing`` says
what the viewer has to know before it draws, ``placing`` and ``coding`` hold the codes. ``page``
writes them into HTML, with the viewer. The viewer itself:

- ``unpack.js`` turns the bytes into points, σ, reasons and layers;
- ``mesh.js``, ``measure.js``, ``fit.js`` compute what the library computes, with its constants;
- ``scene.js`` with the two shaders draws, ``view.js`` turns;
- ``viewer.js`` with ``viewer.html`` and ``viewer.css`` holds the controls, ``tools.js`` what is
  measured at the cursor, ``input.js`` mouse, touch and keys.

For a page that is written elsewhere (the HTML report, a notebook, the studio)::

    packed = fw.report.pack_surface(measurement, camera=rig, title="part 7")
    html = f"<style>{viewer_style()}</style>{viewer_fragment(packed)}"
    html += f"<script>{viewer_script()}</script>"

The script starts a viewer in every fragment of the page and defines ``FringeViewer``, nothing else.
``new FringeViewer(element, [payload])`` mounts one into an element of a page that is open already,
where ``payload`` is ``PackedSurface.data`` as base64 text or as a ``Uint8Array``. Its ``ready`` is
a promise. The viewer fills its element, to which the page gives a height; ``page.viewer_page``
shows how a content security policy allows the script by its hash. Where the element is narrow, the
controls lie below the picture. Light and dark colours follow the browser.
"""
