# The image of the worker: package, tasks and flows, with everything that draws pictures without a display.
FROM python:3.11-slim

RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl1 libgl1 libgl1-mesa-dri libglu1-mesa libgomp1 libopengl0 \
        libxcursor1 libxfixes3 libxft2 libxinerama1 libxrender1 \
    && rm -rf /var/lib/apt/lists/*

ENV DO_NOT_TRACK=1 \
    PREFECT_SERVER_ANALYTICS_ENABLED=false \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow

WORKDIR /app

# Heavy and rarely changed first: a change of our code leaves these layers alone.
ARG TORCH=torch==2.13.0
RUN pip install --no-cache-dir "${TORCH}"
COPY constraints.txt pyproject.toml README.md ./
COPY src src
RUN pip install --no-cache-dir -c constraints.txt ".[flow]"

COPY tasks tasks
COPY flows flows
COPY prefect.yaml ./

RUN useradd --create-home --uid 10001 meshgen \
    && mkdir -p artifacts reports/generated models \
    && chown -R meshgen artifacts reports
USER meshgen
VOLUME ["/app/artifacts", "/app/reports/generated"]

CMD ["prefect", "worker", "start", "--pool", "local", "--type", "process"]
