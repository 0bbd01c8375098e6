# rebond with PETSc and Open MPI on Debian 12.
#
#   docker build --tag rebond .
#   docker run --rm --volume "$PWD:/work" --user "$(id -u):$(id -g)" rebond run plate.toml
#   docker run --rm --volume "$PWD:/work" --user "$(id -u):$(id -g)" --entrypoint mpirun rebond -n 2 rebond run plate.toml
FROM rust:1-bookworm AS build
WORKDIR /source
# Packages are fetched again only where their list changes.
COPY scripts/setup.sh scripts/setup.sh
COPY Cargo.toml ./
RUN scripts/setup.sh
COPY . .
RUN cargo install --locked --path . --root /opt/rebond \
 && /opt/rebond/bin/rebond man --out /opt/rebond/share/man/man1 \
 && mkdir -p /opt/rebond/share/bash-completion/completions \
 && /opt/rebond/bin/rebond completions bash > /opt/rebond/share/bash-completion/completions/rebond

FROM debian:bookworm-slim
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libpetsc-real3.18 openmpi-bin libopenblas0-pthread \
 && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/rebond /usr/local
# Open MPI refuses to start as root otherwise, as which containers run by default. A container may not
# read the memory of another process, which Open MPI would try, and complain of, before it copies.
ENV OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
    OMPI_MCA_btl_vader_single_copy_mechanism=none REBOND_CACHE=/tmp/rebond
WORKDIR /work
ENTRYPOINT ["rebond"]
CMD ["--help"]
