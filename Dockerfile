# cpic-planner in a container, with the versions of requirements-lock.txt checked by their hashes.
#   docker build --tag cpic-planner . && docker run --rm cpic-planner etc "tau Cet" --snr 10
# Results: docker run --rm --volume "$PWD:/work" --user "$(id -u):$(id -g)" cpic-planner plan --out plan
FROM python:3.12-slim AS build
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir --target /installed --require-hashes --requirement requirements-lock.txt \
 && pip wheel --no-cache-dir --no-deps --wheel-dir /wheel . \
 && pip install --no-cache-dir --target /installed --no-deps /wheel/*.whl

FROM python:3.12-slim
COPY --from=build /installed /usr/local/lib/python3.12/site-packages
ENV HOME=/tmp CPIC_CACHE_DIR=/tmp/cpic NUMBA_CACHE_DIR=/tmp/numba MPLCONFIGDIR=/tmp/matplotlib
RUN useradd --create-home cpic
USER cpic
WORKDIR /work
ENTRYPOINT ["python", "-m", "cpic_planner.cli.main"]
