"""What is in a frame before analysis: noise, the response of projector and camera, denoising."""
