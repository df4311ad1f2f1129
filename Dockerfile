# The service in a small image: built in one stage, run from another as a user of its own.
#   docker build -t safe-rrt-companion .
#   docker run --rm --device /dev/ttyAMA0 -v ./my-mission.yaml:/etc/companion/mission.yaml:ro \
#       -v companion-flights:/var/lib/companion safe-rrt-companion \
#       run /etc/companion/mission.yaml --link serial:///dev/ttyAMA0:921600
# Nothing here depends on the processor: `docker buildx build --platform linux/amd64,linux/arm64` makes both.
# packaging/prove_image.py carries out these very steps in a clean Debian, without a registry.
FROM python:3.11-slim-bookworm AS build
WORKDIR /src
COPY pyproject.toml setup.py README.md ./
COPY requirements requirements
COPY companion companion
# Left out at the end: the installer, the libraries' own tests, dialects of MAVLink that nothing reads and the
# tools that make them, numba's part for GPUs, numpy's builder of extensions, all of scipy but its linear
# algebra, what only compilers and type checkers read, pymavlink's XML parser, and matplotlib, which filterpy
# names but whose one file used here does without: pictures and reports are made where recordings are taken to. Symbols go from libraries but those in
# *.libs and numba's thread pools: these were patched after they were linked, and strip would break them.
# Every package has the hash that requirements has of it. What the image then holds of Python is listed in
# /opt/companion/share/sbom.cdx.json (CycloneDX), made by a program that does not come into the image.
# Times of files are whole seconds, as a registry keeps them: numba compares them with its cache's.
RUN --mount=type=cache,target=/root/.cache/pip apt-get -qq update \
    && apt-get -qq install --yes --no-install-recommends binutils > /dev/null \
    && python -m venv /opt/companion \
    && /opt/companion/bin/pip install --quiet --no-compile --only-binary :all: --require-hashes \
        -r requirements/service.txt \
    && /opt/companion/bin/pip install --quiet --no-compile --no-deps --no-build-isolation . \
    && python -m venv /opt/sbom \
    && /opt/sbom/bin/pip install --quiet --only-binary :all: --require-hashes -r requirements/sbom.txt \
    && /opt/companion/bin/pip uninstall --quiet --yes lxml matplotlib contourpy cycler fonttools kiwisolver \
        pillow pyparsing python-dateutil pip setuptools \
    && mkdir -p /opt/companion/share \
    && /opt/sbom/bin/cyclonedx-py environment --output-reproducible --output-format JSON \
        --output-file /opt/companion/share/sbom.cdx.json /opt/companion/bin/python \
    && cd /opt/companion/lib/python3*/site-packages \
    && find . -type d -name tests -prune -exec rm -rf {} + \
    && find pymavlink/dialects -name '*.py' ! -name __init__.py ! -path '*/v20/ardupilotmega.py' -delete \
    && rm -r numba/cuda numpy/distutils pymavlink/dfindexer pymavlink/generator pymavlink/tools \
    && find . -type f \( -name "*.pyi" -o -name "*.pxd" -o -name "*.a" \) -delete \
    && find scipy -mindepth 1 -maxdepth 1 -type d ! -name linalg ! -name '_*' -exec rm -rf {} + \
    && find . -type f -name '*.so*' ! -path './*.libs/*' ! -name '*pool.*' -exec strip --strip-unneeded {} + \
    && find . -exec touch --no-dereference --date=2026-01-01 {} +

FROM python:3.11-slim-bookworm
RUN useradd --system --create-home --home-dir /var/lib/companion --groups dialout companion \
    && install -d -o companion -g companion /var/cache/companion
COPY --from=build /opt/companion /opt/companion
COPY mission_configs /usr/share/companion/mission_configs
ENV PATH=/opt/companion/bin:$PATH NUMBA_CACHE_DIR=/var/cache/companion NUMBA_CPU_NAME=generic \
    COMPANION_METRICS=9105 PYTHONUNBUFFERED=1 OPENBLAS_NUM_THREADS=1
# Kernels are compiled here, so that the service plans at once. They are for any processor of the
# architecture: compiled for the one that builds the image, they would not be used on another. What is
# imported for it leaves its .pyc, of the standard library, too: the service's user could write none.
RUN python -c 'import companion.research.campaign.runs, companion.service.doctor.doctor_command' \
    && python -c 'import companion.service.replay.replay_command, companion.service.process.service' \
    && companion warm-up \
    && chown -R companion:companion /var/cache/companion
USER companion
WORKDIR /var/lib/companion
# Asks the planning loop, not the process: one that hangs is unhealthy.
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s --retries=3 CMD ["companion", "health"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["companion"]
CMD ["--help"]
