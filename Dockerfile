# A headless scanner: `fringeworks serve` on the folder /data, which holds rig.toml and setup.toml.
FROM rust:1.87-slim-bookworm AS build
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-venv=3.11.* \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /build
COPY constraints.txt ./
RUN python3 -m venv /tools \
    && /tools/bin/pip install --no-cache-dir --constraint constraints.txt maturin
COPY Cargo.toml Cargo.lock pyproject.toml README.md LICENSE ./
COPY crates crates
COPY src src
RUN /tools/bin/maturin build --release --locked --out /wheels

FROM python:3.11-slim-bookworm
# What the extra "service" needs, with hashes; then the wheel alone.
COPY requirements/hashed-service.txt /tmp/hashed.txt
COPY --from=build /wheels /tmp/wheels
RUN pip install --no-cache-dir --require-hashes --requirement /tmp/hashed.txt \
    && pip install --no-cache-dir --no-index --no-deps /tmp/wheels/*.whl \
    && pip check \
    && rm -rf /tmp/wheels /tmp/hashed.txt \
    && useradd --create-home --uid 10001 scanner \
    && mkdir /data \
    && chown scanner /data
USER scanner
WORKDIR /data
VOLUME /data
EXPOSE 8138
HEALTHCHECK --interval=30s --timeout=5s --start-period=30s \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8138/health', timeout=4)"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["fringeworks", "serve", "/data", "--host", "0.0.0.0", "--port", "8138"]
CMD ["--rig", "/data/rig.toml", "--setup", "/data/setup.toml"]
