# Two images: `server` has Prefect and nothing of ours, `worker` package, tasks and flows, with everything that draws
# pictures without a display. Default: worker.
FROM python:3.11-slim AS base
ENV DO_NOT_TRACK=1 \
    PREFECT_SERVER_ANALYTICS_ENABLED=false \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1
WORKDIR /app
RUN useradd --create-home --uid 10001 meshgen
COPY constraints.txt ./

FROM base AS server
RUN pip install --no-cache-dir -c constraints.txt prefect fastapi "sqlalchemy[asyncio]" asyncpg
USER meshgen
EXPOSE 4200
CMD ["prefect", "server", "start", "--host", "0.0.0.0", "--port", "4200"]

FROM base AS worker
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 libgl1 libgl1-mesa-dri libglu1-mesa libgomp1 libopengl0 \
        libxcursor1 libxfixes3 libxft2 libxinerama1 libxrender1 \
    && rm -rf /var/lib/apt/lists/*
ENV VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow

# Heavy and rarely changed first: a change of our code leaves these layers alone.
ARG TORCH=torch==2.13.0
RUN pip install --no-cache-dir "${TORCH}"
COPY pyproject.toml README.md ./
COPY src src
RUN pip install --no-cache-dir -c constraints.txt ".[flow,s3]"

COPY tasks tasks
COPY flows flows
COPY prefect.yaml ./

RUN mkdir -p artifacts reports/generated models \
    && chown -R meshgen artifacts reports
USER meshgen
# Compiles kernels, which the first mesh of every container would wait for; an image that cannot mesh is not built.
RUN drl-meshgen mesh hemisphere --triangles 5000 --target-quads 100 --no-pictures --out /tmp/first && rm -r /tmp/first
VOLUME ["/app/artifacts", "/app/reports/generated"]
EXPOSE 4300
CMD ["prefect", "worker", "start", "--pool", "local", "--type", "process"]
