"""A CLIP of two layers with random weights, in the format of the real ones."""

from __future__ import annotations

import json
from pathlib import Path

import torch

FEATURES = 12


def tiny_clip(folder: Path, seed: int = 0) -> Path:
    """Save one that knows the letters as ``save_pretrained`` does."""
    from transformers import CLIPConfig, CLIPModel, CLIPTokenizer  # takes seconds and 100 MB

    letters = [chr(code) for code in range(ord("a"), ord("z") + 1)]
    words = [*letters, *(f"{letter}</w>" for letter in letters)]
    words += ["<|startoftext|>", "<|endoftext|>"]
    (folder / "words").mkdir(parents=True)
    vocabulary, merges = folder / "words" / "vocab.json", folder / "words" / "merges.txt"
    vocabulary.write_text(json.dumps({word: number for number, word in enumerate(words)}))
    merges.write_text("#version: 0.2\n")
    tower = {
        "hidden_size": 16,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
    }
    ends = {"bos_token_id": len(words) - 2, "eos_token_id": len(words) - 1}
    config = CLIPConfig(
        text_config={**tower, **ends, "vocab_size": len(words)},
        vision_config={**tower, "image_size": 32, "patch_size": 8},
        projection_dim=FEATURES,
    )
    torch.manual_seed(seed)
    CLIPModel(config).save_pretrained(folder)
    CLIPTokenizer(str(vocabulary), str(merges)).save_pretrained(folder)
    return folder
