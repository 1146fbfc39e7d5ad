# The page of `nsdr serve`, on the CPU:  docker build -t nsdr . && docker run --rm -p 127.0.0.1:7860:7860 nsdr
# A folder of clips to pick from:        docker run --rm -p 127.0.0.1:7860:7860 -v "$PWD/clips:/clips:ro" nsdr /clips
FROM python:3.11-slim
RUN pip install --no-cache-dir torch torchvision --index-url https://download.pytorch.org/whl/cpu
COPY pyproject.toml README.md LICENSE /src/
COPY checkpoints /src/checkpoints
COPY configs/pipeline /src/configs/pipeline
COPY nsdr /src/nsdr
RUN pip install --no-cache-dir '/src[web]' && rm -r /src
RUN useradd --create-home nsdr
USER nsdr
WORKDIR /home/nsdr
# Tries the installation, and keeps what Numba compiles.
RUN nsdr demo
EXPOSE 7860
ENTRYPOINT ["nsdr", "serve", "--host", "0.0.0.0"]
