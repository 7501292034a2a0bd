// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Starts `epson_driver spel server` and gives it the SPEL+ files of the workspace.
const { workspace } = require('vscode');
const { LanguageClient } = require('vscode-languageclient/node');

let client;

exports.activate = function activate() {
  const settings = workspace.getConfiguration('spel');
  const [command, ...args] = settings.get('command');
  client = new LanguageClient('spel', 'SPEL+', { command, args }, {
    documentSelector: ['spel', 'spel-data'].map((language) => ({ scheme: 'file', language })),
    initializationOptions: { version: Number(settings.get('version')) },
    synchronize: {
      fileEvents: workspace.createFileSystemWatcher('**/*.{prg,inc,pts,PTS,sprj,dat,yaml}'),
    },
  });
  return client.start();
};

exports.deactivate = () => client?.stop();
