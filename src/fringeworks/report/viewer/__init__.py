"""The viewer of surfaces: a page of plain JavaScript and WebGL2 that needs no server.

``pack`` turns results into compact bytes (``coding`` holds the codes), ``page`` writes them with the
viewer into HTML. The viewer itself is ``unpack.js`` (bytes to points), ``measure.js`` (triangles,
normals, picks, fits), ``scene.js`` (WebGL2), ``viewer.js`` (controls) and ``viewer.css``.

For a page that is written elsewhere (the HTML report, a notebook, the studio)::

    packed = fw.pack_surface(measurement, camera=rig, title="part 7")
    html = f"<style>{fw.viewer_style()}</style>{fw.viewer_fragment(packed)}"
    html += f"<script>{fw.viewer_script()}</script>"

The script starts a viewer in every fragment of the page and defines ``FringeViewer``, nothing else.
``new FringeViewer(element, [payload])`` mounts one into an element of a page that is open already,
where ``payload`` is ``PackedSurface.data`` as base64 text or as a ``Uint8Array``.
"""
