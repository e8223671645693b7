# orip in a container: docker build -t orip . && docker run --rm -v "$PWD:/project" orip run
FROM python:3.13-slim AS build
RUN apt-get update && apt-get install --yes --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY pyproject.toml setup.py README.md LICENSE ./
COPY orip orip
COPY sample_projects sample_projects
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.13-slim
COPY --from=build /wheels /wheels
RUN wheel="$(echo /wheels/*.whl)" && pip install --no-cache-dir "$wheel[exif]" && rm -r /wheels
RUN useradd --create-home surveyor && mkdir /project && chown surveyor /project
USER surveyor
WORKDIR /project
ENTRYPOINT ["orip"]
CMD ["--help"]
