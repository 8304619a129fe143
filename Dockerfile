# The competition's image: every scenario in /commonroad/scenarios, one solution each in
# /commonroad/solutions. How to build, test and hand it in: docs/competition.md
#
#   docker build -t mpcplan .
#   docker build -t mpcplan:sumo1.12 --build-arg PYTHON=3.10 --build-arg SUMO=1.12.0 .

ARG PYTHON=3.11
ARG SUMO=1.28.0

# One dependency comes as source: the compiler stays in this stage.
FROM python:${PYTHON}-slim-bookworm AS build
ARG SUMO
WORKDIR /source
COPY docker/ docker/
RUN apt-get update \
    && xargs apt-get install -y --no-install-recommends < docker/build-packages.txt \
    && rm -rf /var/lib/apt/lists/*
COPY requirements/ requirements/
RUN bash docker/install.sh dependencies /opt/mpcplan "$SUMO"
COPY pyproject.toml README.md LICENSE ./
COPY mpcplan/ mpcplan/
RUN bash docker/install.sh package /opt/mpcplan "$SUMO"

FROM python:${PYTHON}-slim-bookworm
# libsumo draws too, and so cannot be loaded without the libraries of a display.
COPY docker/run-packages.txt /tmp/
RUN apt-get update \
    && xargs apt-get install -y --no-install-recommends < /tmp/run-packages.txt \
    && rm -rf /var/lib/apt/lists/* /tmp/run-packages.txt
RUN useradd --uid 1000 --no-create-home --home-dir /tmp mpcplan \
    && mkdir -p /commonroad/scenarios /commonroad/solutions \
    && chown mpcplan /commonroad/solutions
COPY --from=build /opt/mpcplan /opt/mpcplan

# One core for each process: --jobs is the number of processes. /tmp is the one folder that any user
# ("docker run --user") can write.
ENV PATH=/opt/mpcplan/bin:/usr/local/bin:/usr/bin:/bin
ENV HOME=/tmp
ENV MPLCONFIGDIR=/tmp/matplotlib
ENV MPLBACKEND=Agg
ENV OMP_NUM_THREADS=1
ENV OPENBLAS_NUM_THREADS=1
ENV PYTHONDONTWRITEBYTECODE=1
ENV PYTHONUNBUFFERED=1
ENV PYTHONNOUSERSITE=1

USER mpcplan
WORKDIR /commonroad
VOLUME ["/commonroad/scenarios", "/commonroad/solutions"]
ENTRYPOINT ["mpcplan"]
CMD ["compete", "/commonroad/scenarios", "/commonroad/solutions"]
